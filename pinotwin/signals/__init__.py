"""Arrays in, arrays out: filters, derivatives, spectra. Times run down the rows."""

from pinotwin.signals.filters import decimate_zero_phase as decimate_zero_phase
from pinotwin.signals.filters import derivatives as derivatives
from pinotwin.signals.filters import differentiate as differentiate
from pinotwin.signals.filters import edge_samples as edge_samples
from pinotwin.signals.filters import interior as interior
from pinotwin.signals.filters import low_pass as low_pass
from pinotwin.signals.noise import burg as burg
from pinotwin.signals.noise import rms as rms
from pinotwin.signals.noise import roughness as roughness
from pinotwin.signals.sampling import Clock as Clock
from pinotwin.signals.sampling import clock as clock
from pinotwin.signals.sampling import hats as hats
from pinotwin.signals.sampling import joined as joined
from pinotwin.signals.sampling import lagrange_error as lagrange_error
from pinotwin.signals.sampling import runs as runs
from pinotwin.signals.sampling import segments as segments
from pinotwin.signals.sampling import since_start as since_start
from pinotwin.signals.sampling import uniform as uniform
from pinotwin.signals.spectra import autocorrelation as autocorrelation
from pinotwin.signals.spectra import suggest_cutoff as suggest_cutoff
from pinotwin.signals.spectra import welch as welch
