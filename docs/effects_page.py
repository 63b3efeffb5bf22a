"""The page of effects: what a plan decides on, and the knobs of `Fidelity` that each effect sets."""

from __future__ import annotations

from edofsim.capture.fidelity import describe
from edofsim.plan import EFFECTS


def effects_page() -> str:
    """The text of docs/effects.md."""
    lines = [
        "# Effects and their fields",
        "",
        "A plan decides on these effects; each sets fields of `edofsim.capture.Fidelity`. Written by",
        "`python docs/effects_page.py > docs/effects.md`; a test holds the page to the code.",
        "",
        "| effect | field | unit | default | meaning |",
        "|---|---|---|---|---|",
    ]
    for name in EFFECTS:
        lines += [
            f"| {name} | `{knob.name}` | {knob.unit} | `{knob.default!r}` | {knob.meaning} |"
            for knob in describe()
            if knob.effect == name
        ]
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    print(effects_page(), end="")
