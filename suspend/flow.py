"""Flow protocols: strain and rate as functions of the cycle and the time within it.

Time is in units of 1/Gamma. Time within a cycle runs from 0 to `period`, so that a protocol repeats exactly,
whatever the number of cycles. Non-periodic protocols are cut into output blocks of about one unit of strain,
which play the part of cycles; a shear reversal is always the start of a block.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Oscillatory:
    """gamma = gamma0 sin(omega t + phase), rate = cos(omega t + phase) in units of Gamma = gamma0 omega."""

    amplitude: float
    phase: float
    cycles: int

    def period(self, cycle: int) -> float:
        """Duration of a cycle, 2 pi gamma0."""
        return 2.0 * math.pi * self.amplitude

    def strain(self, cycle: int, time: float) -> float:
        """Strain gamma at `time` within the cycle."""
        return self.amplitude * math.sin(time / self.amplitude + self.phase)

    def rate(self, cycle: int, time: float) -> float:
        """Shear rate at `time` within the cycle."""
        return math.cos(time / self.amplitude + self.phase)

    def accumulated(self, cycle: int, time: float) -> float:
        """Total strain since the start, the integral of abs(rate): 4 gamma0 a cycle."""

        def travelled(angle: float) -> float:  # integral of abs(cos) from 0 to angle
            turns = math.floor(angle / math.pi + 0.5)
            return 2.0 * turns + (-1) ** turns * math.sin(angle)

        angle = time / self.amplitude + self.phase
        return self.amplitude * (4.0 * cycle + travelled(angle) - travelled(self.phase))

    def elapsed(self, cycle: int, time: float) -> float:
        """Time since the start of the run."""
        return cycle * self.period(0) + time


@dataclass(frozen=True)
class Steps:
    """Piecewise constant rate: `pre` units of strain at `rate_before`, then `rate_after`, in equal blocks.

    Steady shear has pre = 0 and rate_after = 1; a reversal has rate_before = 1 and rate_after = -1; a
    quiescent fluid has rate 0 throughout, with time in place of strain.
    """

    total: float
    pre: float
    rate_before: float
    rate_after: float

    @property
    def pre_blocks(self) -> int:
        """Number of blocks before the reversal."""
        return math.ceil(self.pre - 1e-12)

    @property
    def cycles(self) -> int:
        """Number of blocks of the whole run."""
        return self.pre_blocks + math.ceil(self.total - self.pre - 1e-12)

    def period(self, cycle: int) -> float:
        """Duration of a block: the parts before and after the reversal are cut evenly.

        Of the block that would follow the last one too, where a finished run stands.
        """
        if cycle < self.pre_blocks or self.cycles == self.pre_blocks:
            return self.pre / self.pre_blocks
        return (self.total - self.pre) / (self.cycles - self.pre_blocks)

    def elapsed(self, cycle: int, time: float) -> float:
        """Time since the start of the run."""
        if cycle < self.pre_blocks or self.cycles == self.pre_blocks:
            return cycle * self.period(0) + time
        return self.pre + (cycle - self.pre_blocks) * self.period(cycle) + time

    def rate(self, cycle: int, time: float) -> float:
        """Shear rate, constant within a block."""
        return self.rate_before if cycle < self.pre_blocks else self.rate_after

    def strain(self, cycle: int, time: float) -> float:
        """Strain gamma."""
        elapsed = self.elapsed(cycle, time)
        if cycle < self.pre_blocks:
            return self.rate_before * elapsed
        return self.rate_before * self.pre + self.rate_after * (elapsed - self.pre)

    def accumulated(self, cycle: int, time: float) -> float:
        """Total strain since the start (dimensionless time where the fluid is quiescent)."""
        return self.elapsed(cycle, time)


Flow = Oscillatory | Steps


def make_flow(config) -> Flow:
    """The protocol of a configuration (`suspend.config.Config`)."""
    flow, duration = config.flow, config.duration
    if flow.type == "oscillatory":
        cycles = duration.cycles or math.ceil(duration.strain / (4.0 * flow.amplitude) - 1e-9)
        return Oscillatory(flow.amplitude, flow.phase, cycles)
    if flow.type == "steady":
        return Steps(duration.strain, 0.0, 1.0, 1.0)
    if flow.type == "reversal":
        return Steps(duration.strain, min(flow.reversal_strain, duration.strain), 1.0, -1.0)
    return Steps(duration.strain, 0.0, 0.0, 0.0)


def rate_scale(config) -> float:
    """Gamma in the configuration's units: gamma0 omega, or the shear (reference) rate."""
    if config.flow.type == "oscillatory":
        return config.flow.amplitude * config.flow.omega
    return config.flow.rate
