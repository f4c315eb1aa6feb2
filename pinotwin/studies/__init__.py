"""Studies of the source on a machine and its logs: how much data, which coupling, which effect matters."""
