"""Reports: self-contained HTML pages with interactive plots, made of a :class:`Page` and its blocks."""

from pinotwin.report.blocks import Block as Block
from pinotwin.report.blocks import Group as Group
from pinotwin.report.blocks import Html as Html
from pinotwin.report.blocks import Plot as Plot
from pinotwin.report.blocks import Tabs as Tabs
from pinotwin.report.diagnosis import diagnosis_report as diagnosis_report
from pinotwin.report.identification import identification_report as identification_report
from pinotwin.report.page import Page as Page

__all__ = ["Block", "Group", "Html", "Page", "Plot", "Tabs", "diagnosis_report", "identification_report"]
