"""The chart of the README, drawn from kept figures: `python docs/chart.py` writes `_static/cost.png`.

It is the chart that `edofsim cost desk --repeats 1` draws, from the file `results/json/cost.json` of such a
run.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

from edofsim.capture import Fidelity
from edofsim.experiments.cost import Case, Measured
from edofsim.experiments.cost_page import cost_plot
from edofsim.report.plot import Plot

DOCS = Path(__file__).parent
SOURCE = DOCS / "results" / "json" / "cost.json"
CHART = DOCS / "_static" / "cost.png"
WIDTH_IN = 7.6


def chart(source: Path = SOURCE) -> Plot:
    """The chart of a kept run of `edofsim cost` of one scene."""
    figures = json.loads(source.read_text(encoding="utf-8"))["figures"]
    rows = []
    for name, seconds in figures.items():
        what, _, case = name.partition(".")
        kind, _, said = case.partition(".")
        if what == "seconds" and kind in ("target", "chosen", "without", "full") and "." not in said:
            db = figures[f"psnr_db.{case}"]
            measured = math.inf if db == "inf" else db
            rows.append(Measured(Case(said.replace("_", " "), kind, Fidelity()), measured, seconds))
    return cost_plot(rows, "desk", WIDTH_IN)


if __name__ == "__main__":
    print(chart().save(CHART))
