"""Reads MAT files in a process of its own, which damaged ones may crash: run by `measurements.load_mat`.

Each line of its input is JSON, [MAT file, NPZ file]. It writes the arrays of one into the other, and answers
with a line of JSON: what was wrong, empty where nothing was.
"""

from __future__ import annotations

import json
import sys

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import mat_struct

NUMBERS_AND_TEXT = "biufcSU"
"""Kinds of arrays that are handed on; of others, such as cells, only the shape is."""


def flat(value: object, arrays: dict[str, np.ndarray]) -> object:
    """A value as JSON: the number of its array, {"shape": ...}, or {"fields": {name: value}}.

    arrays: by number, to which its own are added.
    """
    if isinstance(value, mat_struct):
        return {"fields": {name: flat(getattr(value, name), arrays) for name in vars(value)["_fieldnames"]}}
    array = np.asarray(value)
    if array.dtype.kind not in NUMBERS_AND_TEXT:
        return {"shape": array.shape}
    name = str(len(arrays))
    arrays[name] = array
    return name


def convert(source: str, target: str) -> None:
    found = loadmat(source, squeeze_me=True, struct_as_record=False)
    arrays: dict[str, np.ndarray] = {}
    tree = {name: flat(value, arrays) for name, value in found.items() if not name.startswith("__")}
    arrays["tree"] = np.array(json.dumps(tree))
    with open(target, "wb") as file:
        np.savez(file, allow_pickle=False, **arrays)


if __name__ == "__main__":
    for line in sys.stdin:
        said = ""
        try:
            convert(*json.loads(line))
        except Exception as error:  # damaged files raise many kinds
            said = str(error) or type(error).__name__
        print(json.dumps(said), flush=True)
