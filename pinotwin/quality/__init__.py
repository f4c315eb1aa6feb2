"""What a log is worth: clock, resolution, faults, motion, before anything is fitted to it."""

from pinotwin.quality.inspection import inspect as inspect
from pinotwin.quality.results import AxisQuality as AxisQuality
from pinotwin.quality.results import ChannelQuality as ChannelQuality
from pinotwin.quality.results import Finding as Finding
from pinotwin.quality.results import Limits as Limits
from pinotwin.quality.results import Quality as Quality
from pinotwin.quality.sampling import resample as resample
from pinotwin.signals.sampling import segments as segments

__all__ = [
    "AxisQuality", "ChannelQuality", "Finding", "Limits", "Quality", "inspect", "resample",
    "segments",
]  # fmt: skip
