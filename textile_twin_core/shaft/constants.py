"""Constants of the shaft's recursion and smoothers, by rule: meaning, origin, and what the rule earned.

Lines that begin with `# ..:` state the origin and the figure of the constants below. Figures are errors relative to a
textbook's filter or smoother tuned on the same records, without the rule and with it. "Public" means the geometric
mean over 100 public records of wheels and shafts, "kinds" the records of tests/shaft/kinds.py, both with all other
rules in place; docs/validation/shaft.md has all figures. "No figure" means that the constant was not measured alone.
Constants of the sensor (`encoder`) and the memories of the bank (`layout`) stand beside their code.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from textile_twin_core.shaft import layout
from textile_twin_core.shaft.turns import TURN

# Filters --------------------------------------------------------------------------------------------------------------
# Origin: heavy tails of an operating system's delays. No figure.
FREEDOM: Final = 6.0  # degrees of freedom of the innovations' Student t
ROBUST: Final = 9.0  # maximum normalised innovation squared: beyond it the measurement variance is inflated

# Origin: factor of the white jerk's covariance over a step h (Bar-Shalom, Li and Kirubarajan 2001, 6.2.3), in the order
# acceleration, rate, angle: sqrt(q h) times (1, h/2, h^2/6), (0, HALF_JERK h, HALF_JERK h^2/2), (0, 0, LAST_JERK h^2).
HALF_JERK: Final = math.sqrt(1.0 / 12.0)
LAST_JERK: Final = math.sqrt(1.0 / 720.0)

# Origin: a motion changes a few times in 1000 samples; memories share by use (Bousquet and Warmuth 2002). Figure of
# 4e-3 and 2e-2 instead of 1e-3: public 1.094, 1.076 (causal; then 1.107), 1.352, 1.372 (lag; then 1.341), but late
# stamps of a host become motion: at 2e-2 the speed of a shaft of 20 rad/s is off by up to 8 rad/s, at 1e-3 by under 2.
MEMORY_SWITCH: Final = 1e-3  # probability of a switch from one memory to another at each sample
UNIFORM_PART: Final = 0.01  # part of it for all memories alike; the remainder follows their use
USAGE_SAMPLES: Final = 300.0  # samples over which a memory's probability is averaged as its use

# Origin: test of a change by cumulated likelihood (Page 1954). Public 1.113 and 1.102 (causal).
RESTART_RATIO: Final = math.exp(-10.0)  # likelihood ratio to the model since its peak, below which a filter restarts
RESTART_PROBABILITY: Final = 0.01  # probability below which a filter may restart

# Rule "no restart from longer memories": public 1.102 and 1.102 (causal); kept for a simulated tufting machine.
YOUNG_CYCLES: Final = 5.0  # cycles in which an estimated ripple may still be no ripple ..
UNEVEN: Final = 0.3  # .. unless the speed changes by this part ..
MANY_READINGS: Final = 63.0  # .. or a turn has fewer readings than this, too few to be too certain

# Noise scale of a filter. Rule "fall of the noise scale": public 1.109 and 1.102 (causal).
FIRST_SCALE_WEIGHT: Final = 0.1  # weight of the first noise scale, in innovations: it may be far too large
SCALE_SAMPLES: Final = 500.0  # innovations over which noise scales and orders are averaged
KNOWN_SCALE: Final = 100.0  # innovations after which the first noise scale counts as known
RECENT_SAMPLES: Final = 50.0  # latest innovations, whose scale replaces the average ..
FALLEN: Final = 0.1, 0.03  # .. where it is this part of the average: among the first SCALE_SAMPLES, and later
LEAST_SCALE: Final = 1e-6  # least noise scale of a filter without any other bound

# Models ---------------------------------------------------------------------------------------------------------------
# Origin: linkages of 1 to 20 % ripple. Figure of the models: engine 0.0036 rad without, 0.0015 with, in a prototype.
RIPPLE_SIZE: Final = 0.05  # prior standard deviation of the speed's ripple in each order, relative to the speed
LEAST_SLOPE: Final = 0.3  # of a clock over the angle, dphi/dtheta: a clock that stands still measures nothing
MODEL_SWITCH: Final = 1e-5  # from one model to another at each sample, and of a model that enters after another one
SIMPLER: Final = 10.0  # where several models enter at once, each is this many times as probable as the next
SEEN_CYCLES: Final = 1.25  # cycles of motion after which a model enters the comparison
COMPARABLE: Final = 1e-3  # probability at which a model of fewer orders than the leading one is preferred
MINOR: Final = 0.05  # part of the greatest probability below which a filter does not enter the mixture
SECOND_ORDER_EVERY: Final = 8.0  # samples between updates of g2, which changes slowly

# Origin: saves time of models that do not lead. Rule "faster return": public 1.101 and 1.102 (causal).
IMPROBABLE: Final = 0.05  # model probability up to which a model may be suspended, and has no memory of its own
TRIAL_CYCLES: Final = 8.0  # until suspension: of an improbable model, or one with more orders than the leading one ..
LONGEST_TRIAL: Final = 32.0  # .. and of the latter while it is nearly as good
FIRST_IDLE: Final = 16.0  # cycles of a suspension, which doubles each time ..
LONGEST_IDLE: Final = 256.0  # .. up to this
SIMPLER_IDLE: Final = 0.25  # part of that for models of fewer orders: needless orders disturb the acceleration
FASTEST_IDLE: Final = 32.0  # factor by which suspensions shorten at most where memory is short

# Origin: 2 samples a wave (Nyquist) and a margin. Figure: four orders at 7.3 readings a turn 0.11, where all fit 0.02.
SAMPLES_PER_WAVE: Final = 2.3  # needed by a model's highest order
EDGES_PER_WAVE: Final = 3.0  # the same for edges of teeth, which sample nearly the same angles in each turn
BEGIN: Final = 1.05  # times that many samples to start an order with ..
KEEP: Final = 0.95  # .. and to keep it

# Figure of the model of 24 orders: impacts and gears 0.6 to 1.8 without, 0.03 to 0.04 with (causal).
HIGH_ORDERS: Final = 0.75  # part of the time with high orders: 700 readings in a row at first
UNBIASED: Final = layout.numbers(layout.COUNT)[np.argmin(np.abs(layout.MEMORIES[: layout.END[layout.PLAIN]] - 1.0))]
"""Index of the plain filter with a memory of one sample: ripple biases longer memories, shorter ones are noisy."""

# Samples --------------------------------------------------------------------------------------------------------------
# Origin: range of float64. No figure.
LARGEST: Final = 1e12  # angle [rad] and stamp [s]: larger ones are no motion, and their squares would overflow
FINEST_S: Final = 1e-9  # [s] least time between readings: months after the first one rounding would hide it

# Origin: pauses of network and disk. No figure.
GAP_SAMPLES: Final = 50.0  # intervals without a sample that make a gap
MAX_SPREAD: Final = 1.0 / 6.0  # sigma of a predicted angle, in periods, from which the turn is ambiguous

# Rule "bunched readings". Figure: an error of 2000 rad/s from the slope in a packet without.
BUNCHED_STEP: Final = 0.1  # part of the mean interval: readings closer in time arrived late, together, and are not used

# Rule "mean interval". Figure of the memory for edges: a run-up at 3.0, 1.3, 0.4 rad/s with 500 for edges.
INTERVAL_SAMPLES: Final = 500.0  # memory of the mean interval
INTERVAL_EDGES: Final = 60.0  # the same for edges, whose intervals follow the speed
MOST_GAIN: Final = 0.2  # maximum weight of a single move in their mean
USUAL_STEP: Final = 1.5  # intervals up to which no sample is missing between two readings

# Origin: chosen on starts of the kinds. No figure.
SETTLING: Final = 25.0  # samples until a state may count as converged, and at standstill until it is reported
MAX_SPEED_SIGMA: Final = 0.25  # largest speed sigma of a converged state, over the speed
LEAST_SPEED: Final = 0.3  # least speed in that rule, over the highest speed so far
FAR_FROM_READING: Final = TURN / 10.0  # [rad] from the reading that a state used, beyond which it has not converged

# Unwrapping -----------------------------------------------------------------------------------------------------------
# Figure of 400 simulated machines that start and stop: wrong turn at the end in 79 without the rules, 0 with them.
FAR_ROUND: Final = 2.0  # periods from the encoder's 0 beyond which a first reading is not wrapped
RANGE: Final = 1.25  # periods that the readings of an unwrapped angle span
MAX_GAP_SIGMA: Final = 0.05  # [rad] predicted across a gap or a turn: 1 in 20 other motions passes 3 sigma by chance

# Rule "one rejection more above full speed": public 1.103 and 1.102 (causal); simulated losses, 95 and 0.2 rad/s^2.
MAX_SPEED_RATIO: Final = 2.0  # of the highest speed so far, above which a move is unlikely: outliers line up

# Noise of the readings ------------------------------------------------------------------------------------------------
# Origin: rounding of float64; no shaft's motion is smoother than 10 urad for long. No figure.
FINEST_RAD2: Final = 1e-14  # [rad^2] least measurement variance: float64 rounding some hundred turns from the origin
FINEST_MOTION: Final = 1e-10  # [rad^2] least variance that the process noise is relative to
FORGET_NOISE: Final = 0.9  # decay, per sample, of the noise that the process noise is relative to

# Rule "correlated rounding": readings that share a rounding error (Widrow and Kollar 2008). Public 1.112 and 1.102.
MOST_CORRELATED: Final = 16.0  # maximum of `correlated`: a shaft at standstill stays within an encoder step for hours
ROUNDED_APART: Final = 1.3  # encoder steps beyond the predicted move from which two rounding errors are uncorrelated
MAX_STEP_INNOVATION: Final = 1.5  # innovation, in moves, up to which a rejected reading counts for the encoder's step

# Rule "bound of the jitter by white noise" (Rice 1984): public 1.107 and 1.102, oscillating arms 1.37 and 1.09 without.
FIRST_JITTER: Final = 0.01  # initial standard deviation of the stamps, in intervals
ADAPT_EVERY: Final = 32.0  # samples between two adaptations of the jitter
LEARN_JITTER: Final = 0.5  # gain of the jitter's adaptation at full speed; lower speeds hardly show jitter
LEAST_JITTER: Final = 0.01  # least part of the estimated noise that counts as jitter
FOURTH: Final = 70.0  # variance of the fourth differences of white noise of variance 1
MOST_WHITE: Final = 2.0  # bound of jitter in estimates of white noise ..
FORGET_WHITE: Final = 0.5  # .. and their decay per adaptation
FORGET_SPEED: Final = 0.99  # decay of the full speed per adaptation

# Rule "additive noise": resolvers, vibrating encoders. Public 1.126 and 1.102 (causal).
SMOOTH_MOVE: Final = TURN / 48.0  # [rad] per interval, up to which the shortest wave of ripple has at least 4 samples
ADDITIVE_SAMPLES: Final = 100.0  # memory of the additive noise ..
ADDITIVE_FEW: Final = 50.0  # .. and where a wave has fewer samples
MOST_ADDITIVE: Final = 128.0  # bound of one sample's estimate, in current variances

# Rule "repeated readings": drive buses and PLCs. Figure: 1450 to 1800 of 4000 true readings rejected without
# SIMILAR_REPEATS.
REPEAT_MEMORY: Final = 10.0, 25.0  # moves averaged at first and at most; a tenth of the readings used in between
REPEATING: Final = 0.3  # share of moves after repetitions above which the sensor repeats values
LARGE_MOVE: Final = 2.5  # encoder steps of a move that rounding cannot explain ..
LARGE_MOVE_GUESSED: Final = 4.5  # .. and while the step is a guess
FORGET_REPEAT: Final = 0.98  # decay of the longest repetition per large move
SIMILAR_REPEATS: Final = 0.6  # part of the longest, from which repetitions are a sensor's

# Rule "guessed step". Figure: 11 states at standstill during an inching move without.
FEW_EQUAL: Final = 2.0  # equal readings between two steps ..
SAME_MOVE: Final = 0.01  # .. and part of a step by which these may differ

# Gate -----------------------------------------------------------------------------------------------------------------
# Origin: one reading in 130; densities omit the constant 0.38 of Student's t: 0.02 * 0.38 = 1 / 130. No figure.
OUTLIER_DENSITY: Final = 0.02  # of outliers in the gate [1/rad]
MAX_OUTLIERS: Final = 2  # consecutive readings rejected as outliers before a manoeuvre may be declared
MAX_UNCONFIRMED: Final = 9  # rejected readings, less those accepted since, beyond which the track is lost
UNCONFIRMED: Final = 7.0  # readings that must fit after a manoeuvre

# Rule "one rejection in a clean record": public 1.295 and 1.102 (causal), a motor's voltage in steps 2.89 and 1.41.
CLEAN_SAMPLES: Final = 100.0  # samples without an outlier, after which one rejection fewer is enough
GROWTH: Final = 1.25  # ratio of two successive innovations from which they grow as in a manoeuvre

# Rule "acceptance at once": public 1.378 and 1.102 (causal), a robot's wheels 1.46 and 1.04.
FORGET_ABRUPT: Final = 0.97  # memory of `abrupt` ..
MOST_ABRUPT: Final = 2.0  # .. its bound ..
OUTLIER_WEIGHT: Final = 3.0  # .. and the weight of an outlier in it; a manoeuvre has 1
NEARER: Final = 0.5  # ratio of distances from which a reading confirms a track: after a slip both are equal

# Rule "equal innovations wait": public 1.115 and 1.102 (causal), a robot's wheels 1.08 and 1.04.
SLIPPED: Final = 0.25  # part of an innovation by which innovations of a slipped encoder differ at most
# Rule "no second slip": public 1.101 and 1.102 (causal); simulated polls of a controller: speed 6 to 9 without.
SLIPS_APART: Final = 15.0  # samples between two slips in the same direction
# Rule "runaway speed": no public record; speeds up to 1e112 in simulated records of few readings without.
RUNAWAY: Final = 8.0  # ratio of the predicted to the mean measured move that no real shaft keeps up
# Rule "false start": public 1.103 and 1.102 (causal); simulated: speed wrong by a quarter without.
FALSE_START: Final = 4.0  # innovation, in deviations from the line through the latest readings
# Figure of a sensor's speed at initiation only: acceleration error 10 times larger if used later.
SENSOR_SPEED_SIGMA: Final = 0.02  # relative standard deviation of a sensor's own speed

# Orders of the residuals ----------------------------------------------------------------------------------------------
ORDERS: Final = layout.WIDEST  # maximum number of averaged orders: the basis holds no more
KEEP_ORDER: Final = 1.0 - 1.0 / SCALE_SAMPLES  # decay of an order's average at each reading
RESOLVED_SHARE: Final = 0.9  # of the samples per turn, up to which orders differ from their aliases

# Origin: chance, for exponentially distributed powers: 1 case in a million, and (F of 2 and 24) in 140 000.
HIGH_SIGNIFICANT: Final = 14.0  # times the mean power of white residuals in an order above the usual ones
ABOVE_SENSOR: Final = 20.0  # times the sensor's power; 15 rad/s^2 in 1 record of 100 at 10 times

# Rule "orders beyond the model": torque within one sigma on 13 machines with a flywheel and 5 mill machines (`smooth`)
# 0.03 to 0.96 with the highest modelled orders alone, 0.69 to 0.94.
TAIL_ORDERS: Final = 3  # orders that predict the next one
SIMPLER_EVIDENCE: Final = math.log(SIMPLER)  # of a ripple that ends with the model's orders
OMITTED: Final = 0.9  # least part of an order that a smoother does not follow, for it to count as omitted
FALL: Final = (np.arange(ORDERS + 1.0) / np.arange(1.0, ORDERS + 2.0)) ** 6
"""Fall of the angle's power from one order to the next: the orders of a torque with steps fall as 1 / k."""

# Rule "sensor's part". Figure: 0.03 to 0.04 rad/s^2 with, 9 to 19 without.
FEWEST_ORDERS: Final = 5  # orders needed to estimate the sensor's power
LOG_MEAN: Final = 0.5772  # log of the mean less mean of the logs of exponentially distributed powers ..
LOG_SIGMA: Final = 1.2825  # .. and standard deviation of the logs
FLAT: Final = 2.5  # sigmas by which the lower half's power exceeds the upper's: at most for a sensor ..
FALLING: Final = 3.5  # .. and at least for motion
FROM_WHITE: Final = 3.0  # times the power of white residuals, above which the excess counts as the sensor's

# Smoothing ------------------------------------------------------------------------------------------------------------
# Rule "repeated adaptation of q" (MacKay 1992). Figure: a state wrong by 70 rad/s with one pass.
DELAY: Final = 20.5  # independent samples until a filter detects a change; no integer: rounding decides no comparison
STEADY: Final = 80.0  # memory in samples beyond which the delay grows in proportion to it
WINDOW_FREEDOM: Final = 8.0  # degrees of freedom in a row's window ..
WIDEST_WINDOW: Final = 512  # .. and its maximum rows on either side
PRIOR_WEIGHT: Final = 0.5  # degrees of freedom of the prior ratio 1
LONGEST: Final = 0.5 * 2.0**15  # memories that bound the intensity, in samples
SHORTEST: Final = 0.25
MOST_PASSES: Final = 5  # of the adaptation
FAR_OFF: Final = 4.0  # factor of a wrong process noise from which it is adapted again

# Rule "restart of `lag`". Figure: diverged for a hundred samples without.
FAR: Final = 9.0  # squared distance from the bank's angle, in its variances, that restarts the smoother ..
SURELY_FAR: Final = 1e4  # .. and without a reading
ROUNDED: Final = 1e-30  # least remaining part of a variance that rounding would cancel
MOST_ROWS: Final = 512  # maximum rows in the window of `lag`: a longer lag at a high rate is cut
BATCH: Final = 3  # rows are released when they are 1 / BATCH of those beyond them: one backward pass serves all of them
CERTAIN: Final = 0.5  # model probability from which a model's ripple is used for smoothing

# Rule "revoked manoeuvre": no public record; 170 rad/s on a simulated shaft of 12 without.
BURST: Final = 10  # rows in which a manoeuvre may be revoked ..
REVOKED_NEARER: Final = 0.25  # .. and ratio of distances at which it is

# Rule "variance of unit weight" (Baarda 1968). No figure.
FIRST_WEIGHT: Final = (1.0, 25.0)  # initial factor, and the number of redundant measurements that it counts for
CLIP: Final = 4.0  # residuals beyond two deviations count as two: outliers are no noise
CLIPPED: Final = 0.9205  # mean of min(z^2, CLIP) of a normal z
LEAST_REDUNDANCY: Final = 0.05
BOUND: Final = 4.0  # of the factor and its inverse: exact readings promise nothing about later ones

# Rule "ripple of each part": ripple that changes with the speed, 0.03 to 0.04 with. Public 0.896 and 0.896 (smooth).
LOOK_EVERY: Final = 1024  # samples between two checks whether the ripple has changed
FIRST_LOOK: Final = 128  # samples until the first check; the interval then doubles up to LOOK_EVERY
CHANGED: Final = 0.25  # a change exceeds this part of a measurement's sigma ..
UNSURE: Final = 3.0  # .. and this multiple of the sigma of the ripples' difference
LESS_SURE: Final = 2.0  # ratio of sigmas from which the earlier estimate of the same ripple stays
MOST_KNOWN: Final = 64  # maximum number of stored ripples; beyond, every second one is dropped
LEAST_LED: Final = 0.05  # part of a stretch in which a model must lead to be a candidate
MODEL_PARTS: Final = 32  # parts of a long stretch ..
MODEL_ROWS: Final = 256  # .. and rows of each, that suffice to select its model
OVERLAP: Final = 512  # rows on either side of a part that are smoothed along with it
FEWEST_ROWS: Final = 4  # rows below which a stretch keeps the filter's states

# Rule "first memories from the next rows": public 0.896 and 0.897 (smooth); an inertia 5 and 1 % off.
PENALTY: Final = 0.5  # log-likelihood for each row with a memory of its own
CONVERGENCE: Final = 128  # first rows of a stretch, in which the bank may not have converged

# Pitch errors of teeth. Figure: engine, learnt by `smooth` 0.24 mrad, raw 2.07.
PITCH_PASSES: Final = 4  # smoothing passes whose residuals correct the teeth's pitch errors
LEAST_LEFT: Final = 1e-4  # least part of the readings' variance without pitch errors

# Rule "less noise by cross-validation" (Stone 1974): engine, one pass: 0.65 mrad without, 0.22 with; public 0.98, 0.90.
LESS_NOISE: Final = 0.01  # the other hypothesis on the readings' variance, relative to the filter's
HELD_EVERY: Final = 5  # one accepted reading of so many is held out ..
FEWEST_HELD: Final = 50  # .. and their least number
HELD_PARTS: Final = 4  # parts of a long stretch in which readings are held out
BETTER: Final = 0.8  # ratio of the held-out readings' squared errors up to which the other hypothesis is adopted
HELD_CLIP: Final = 9.0  # times the median squared error, to which errors are clipped
NORMAL_MEDIAN: Final = 0.455  # median of the square of a normal deviate
INDEPENDENT: Final = 2.0  # readings that share a rounding error, up to which their errors count as independent
