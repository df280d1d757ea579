"""Bayesian inference: every number of a machine and its sensors is a parameter with a prior.

`record` holds the measurements, `torque_model` the predicted torque and its slopes by every parameter, `priors` the
tolerance of each number, `map_fit` the robust fit, `evidence` the criterion for departures from the machine file,
`posterior` the departures, and `settled` the values with their standard deviations.
"""
