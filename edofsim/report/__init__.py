"""Figures and pages: what a run or an experiment shows to people.

`write_report` makes the page of a run. `Page`, its blocks and `Plot` make any other page in the same style.
"""

from .crops import Detail, choose_crops
from .figures import depth_plot
from .from_pipeline import write_run_report
from .model import DepthRange, ImageScore, PlanRow, Psfs, RunReport
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
from .run_page import report_page, verdict, write_report

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
    "PlanRow",
    "Plot",
    "Psfs",
    "SideBySide",
    "RunReport",
    "Section",
    "Table",
    "Text",
    "choose_crops",
    "depth_plot",
    "index_page",
    "line_plot",
    "page_html",
    "picture",
    "report_page",
    "verdict",
    "write_page",
    "write_report",
    "write_run_report",
]
