"""Energy and momentum balances of a run; the simulation and ``ffsm analyze`` call the same functions."""
