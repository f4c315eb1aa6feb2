"""Reports: self-contained HTML pages with interactive plots, made of a :class:`Page` and its blocks."""

from pinotwin.report.blocks import Block, Group, Html, Page, Plot, Tabs
from pinotwin.report.diagnosis import diagnosis_report
from pinotwin.report.identification import identification_report

__all__ = ["Block", "Group", "Html", "Page", "Plot", "Tabs", "diagnosis_report", "identification_report"]
