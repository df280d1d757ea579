"""The elastic main shaft: a chain of stations whose inertias are linkages, and its resonances."""

from textile_twin_core.driveline.chain import ElasticShaft as ElasticShaft
from textile_twin_core.driveline.chain import ShaftChain as ShaftChain
from textile_twin_core.driveline.chain import bare_shaft as bare_shaft
from textile_twin_core.driveline.chain import elastic_shaft as elastic_shaft
from textile_twin_core.driveline.motion import ChainMotion as ChainMotion
from textile_twin_core.driveline.motion import follow_motion as follow_motion
from textile_twin_core.driveline.resonances import CriticalSpeed as CriticalSpeed
from textile_twin_core.driveline.resonances import Resonances as Resonances
from textile_twin_core.driveline.resonances import ShaftMode as ShaftMode
from textile_twin_core.driveline.resonances import find_modes as find_modes
from textile_twin_core.driveline.resonances import find_resonances as find_resonances
from textile_twin_core.driveline.step import ChainState as ChainState
from textile_twin_core.driveline.step import chain_state as chain_state
from textile_twin_core.driveline.step import midpoint_step as midpoint_step
