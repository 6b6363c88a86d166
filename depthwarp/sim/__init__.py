"""Simulation loops: depth cameras in thousands of worlds, with nothing to wait for.

`DepthSensor` draws; `jax_step` makes its step a function for `jax.jit`. Gradients are those of the
winning points: `launch_winner_depth` in Warp, and `winner_depth` of `depthwarp.sim.torch_gradients`
and `depthwarp.sim.jax_gradients`, which import torch and JAX.
"""

from depthwarp.sim.jax_call import jax_step
from depthwarp.sim.noise import SensorNoise
from depthwarp.sim.se3 import se3_exp, twist_gradient
from depthwarp.sim.sensor import DepthSensor
from depthwarp.sim.status import WorldStatus
from depthwarp.sim.winners import launch_winner_depth

__all__ = [
    "DepthSensor",
    "SensorNoise",
    "WorldStatus",
    "jax_step",
    "launch_winner_depth",
    "se3_exp",
    "twist_gradient",
]
