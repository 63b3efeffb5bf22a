"""What a user asks for: an accuracy, or the best within a time."""

from __future__ import annotations

import logging
import math
import re
from dataclasses import dataclass, replace

from ..capture.sensor import noise_deviation
from ..errors import InputError
from .effect import Plan, decibels, overall
from .facts import Facts

WITHOUT_NOISE_DB = 50.0
"""Accuracy where the default asks for less error than noise, and the sensor has none."""
SHARE_OF_NOISE = 0.5
RESTORED_DB = 12.0
"""How much nearer than `noise` a photo must be whose restored image is scored: it shifts that PSNR by less
than 0.1 dB."""
HIDDEN_DB = 24.0
"""How far below the noise of the view's rendering the error of such a photo must be at most: what is smaller,
that noise hides."""
LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Target:
    """kind: `noise` (error below half of the sensor's noise), `db`, `full` or `time`.
    db, seconds: asked.
    nearer_db: of `noise`, so much less error, as far as the rendering's noise lets that be seen.
    spent: of these seconds, those that are gone before the photo.
    """

    kind: str = "noise"
    db: float = math.inf
    seconds: float = math.inf
    nearer_db: float = 0.0
    spent: float = 0.0

    @property
    def left(self) -> float:
        """Seconds for what is still to be done."""
        return max(0.0, self.seconds - self.spent)

    def asked_db(self, facts: Facts) -> float:
        """The photo's PSNR that is asked for; infinite for `full` and `time`."""
        if self.kind != "noise":
            return self.db
        usual = _usual_db(facts)
        return usual + self._nearer_db(facts, usual)

    def _nearer_db(self, facts: Facts, usual: float) -> float:
        """`nearer_db`, or as much less as the rendering's noise hides."""
        if not self.nearer_db:
            return 0.0
        hidden = decibels(overall(facts.monte_carlo_noise)) + HIDDEN_DB
        return min(self.nearer_db, max(0.0, hidden - usual))

    def sentence(self, facts: Facts) -> str:
        """In words."""
        if self.kind == "full":
            return "everything that scene and camera have"
        if self.kind == "time":
            gone = f", of which {self.spent:.2g} s are spent" if self.spent else ""
            return f"the best accuracy within {self.seconds:g} s{gone}"
        if self.kind == "db":
            return f"{self.db:g} dB against the full simulation"
        noise = sensor_noise(facts)
        what = f"half of the sensor's noise, {noise:.2g}" if noise else "the sensor has no noise"
        more = self._nearer_db(facts, _usual_db(facts))
        nearer = f", and {more:.3g} dB nearer for what is restored from it" if more else ""
        return f"{self.asked_db(facts):.1f} dB against the full simulation ({what}{nearer})"


def as_accurate(plan: Plan, target: Target | None) -> Target:
    """What a photo to compare with is planned for.

    target: that of the first one, of this plan. An accuracy holds for both, but that nothing is restored from
        the other, so that it need not be `nearer_db`; a time is of the first alone, and the other is planned
        for the accuracy that it came to.
    """
    if target is None or target.kind != "time":
        return replace(target or Target(), nearer_db=0.0)
    return Target("full") if math.isinf(plan.error_db) else Target("db", db=plan.error_db)


RESTORED = Target(nearer_db=RESTORED_DB)
"""What `run` asks for."""


def parse_target(accuracy: str | None, time: str | None, usual: Target | None = None) -> Target:
    """`45dB`, `noise`, `restored` or `full`; or a time such as `20s`.

    usual: where neither is given, None for `noise`.

    Raises InputError for anything else, or both.
    """
    if accuracy and time:
        raise InputError("--accuracy and --time: ask for one of them")
    if time:
        found = re.fullmatch(r"([0-9.]+(?:e-?[0-9]+)?)\s*(s|min|h)?", time.strip())
        value = _number(found[1]) if found else 0.0
        if not value > 0:
            raise InputError(f"--time {time}: give a time such as 20s or 2min")
        return Target("time", seconds=value * {"min": 60, "h": 3600}.get(found[2] if found else "s", 1))
    if not accuracy:
        return usual or Target()
    if accuracy in ("noise", "restored", "full"):
        return {"noise": Target(), "restored": RESTORED, "full": Target("full")}[accuracy]
    found = re.fullmatch(r"(score:)?\s*([0-9.]+)\s*(?:dB)?", accuracy.strip(), re.IGNORECASE)
    value = _number(found[2]) if found else 0.0
    if found is None or not value > 0:
        raise InputError(
            f"--accuracy {accuracy}: give noise, restored (for what a network makes of the photo), full, or "
            "decibels such as 45dB"
        )
    if found[1]:
        LOG.warning("--accuracy %s: this is `restored` now, %g dB nearer than `noise`", accuracy, RESTORED_DB)
        return RESTORED
    return Target("db", db=value)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0


def _usual_db(facts: Facts) -> float:
    """What `noise` asks for."""
    noise = sensor_noise(facts)
    return -20 * math.log10(SHARE_OF_NOISE * noise) if noise else WITHOUT_NOISE_DB


def sensor_noise(facts: Facts) -> float:
    """Root mean square of all of the sensor's noise over the photo."""
    return noise_deviation(facts.camera, facts.levels_of_light)
