"""What a log is worth: clock, resolution, faults, motion, before anything is fitted to it."""

from pinotwin.logs.quality.inspection import inspect as inspect
from pinotwin.logs.quality.results import Finding as Finding
from pinotwin.logs.quality.results import Limits as Limits
from pinotwin.logs.quality.results import Quality as Quality
from pinotwin.logs.quality.sampling import resample as resample
from pinotwin.logs.quality.values import lattice as lattice
