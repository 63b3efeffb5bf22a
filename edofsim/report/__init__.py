"""Figures and pages: what a run or an experiment shows to people.

`write_run_report` makes the page of a run. `Page`, its blocks and `Plot` make any other page in the same
style.
"""

from .crops import DepthRange, Detail, choose_crops
from .figures import ImageScore, depth_plot
from .images_page import Shown, image_page, verdict
from .page import (
    Code,
    Column,
    Compare,
    Gallery,
    Key,
    Keys,
    Link,
    Links,
    Notes,
    Page,
    Pairs,
    Section,
    SideBySide,
    Table,
    Text,
    index_page,
    page_html,
    write_page,
)
from .pictures import Picture, picture
from .plot import Plot, line_plot
from .run_page import run_page, write_run_report

__all__ = [
    "Code",
    "Column",
    "Compare",
    "Detail",
    "DepthRange",
    "Gallery",
    "ImageScore",
    "Key",
    "Keys",
    "Link",
    "Links",
    "Notes",
    "Page",
    "Pairs",
    "Picture",
    "Plot",
    "SideBySide",
    "Section",
    "Shown",
    "Table",
    "Text",
    "choose_crops",
    "depth_plot",
    "image_page",
    "index_page",
    "line_plot",
    "page_html",
    "picture",
    "run_page",
    "verdict",
    "write_page",
    "write_run_report",
]
