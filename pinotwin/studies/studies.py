"""The studies of the thesis as library functions; ``report.study_plots`` draws their results.

| study | thesis |
|---|---|
| :func:`error_against_data` | Fig. 3-6 |
| :func:`coupled_against_decoupled` | Fig. 3-7 |
| :func:`with_and_without` | Fig. 3-8 |
| :func:`ripple_overlay` | Fig. 3-9 |
| :func:`friction_overlay` | Fig. 3-10 |
| :func:`table_overlay` | Fig. 4-10, 4-11 |
| :func:`ripple_orders` | the orders behind Fig. 3-8 and 3-9 |
"""

from pinotwin.studies.amount import ErrorAgainstData as ErrorAgainstData
from pinotwin.studies.amount import error_against_data as error_against_data
from pinotwin.studies.coupling import (
    CoupledAgainstDecoupled as CoupledAgainstDecoupled,
)
from pinotwin.studies.coupling import (
    coupled_against_decoupled as coupled_against_decoupled,
)
from pinotwin.studies.overlay import Overlay as Overlay
from pinotwin.studies.overlay import friction_overlay as friction_overlay
from pinotwin.studies.overlay import ripple_overlay as ripple_overlay
from pinotwin.studies.overlay import table_overlay as table_overlay
from pinotwin.studies.removal import WithAndWithout as WithAndWithout
from pinotwin.studies.removal import with_and_without as with_and_without
from pinotwin.studies.ripple_orders import RippleOrders as RippleOrders
from pinotwin.studies.ripple_orders import ripple_orders as ripple_orders

__all__ = [
    "CoupledAgainstDecoupled",
    "ErrorAgainstData",
    "Overlay",
    "RippleOrders",
    "WithAndWithout",
    "coupled_against_decoupled",
    "error_against_data",
    "friction_overlay",
    "ripple_orders",
    "ripple_overlay",
    "table_overlay",
    "with_and_without",
]
