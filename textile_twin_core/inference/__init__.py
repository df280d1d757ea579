"""One inference: every number of a machine and its sensors is a parameter with a tolerance, and one posterior answers.

`record` holds what was measured, `torque_model` what the machine would give and its slopes by every parameter,
`priors` how well each number is known beforehand, `map_fit` the robust fit, `evidence` the one criterion for what
departs from the machine file, `posterior` what departs, and `settled` the values with their standard deviations.
"""
