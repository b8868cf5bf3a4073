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
    quiescent fluid has rate 0 throughout, with time in place of strain. `block`: length of the blocks after the
    reversal where it is given by what a run was begun with; `total - pre` is then a whole multiple of it.
    """

    total: float
    pre: float
    rate_before: float
    rate_after: float
    block: float | None = None

    @property
    def pre_blocks(self) -> int:
        """Number of blocks before the reversal."""
        return math.ceil(self.pre - 1e-12)

    @property
    def cycles(self) -> int:
        """Number of blocks of the whole run."""
        after = self.total - self.pre
        return self.pre_blocks + (math.ceil(after - 1e-12) if self.block is None else round(after / self.block))

    def period(self, cycle: int) -> float:
        """Duration of a block: the parts before and after the reversal are cut evenly.

        Of the block that would follow the last one too, where a finished run stands.
        """
        if cycle < self.pre_blocks or self.cycles == self.pre_blocks:
            return self.pre / self.pre_blocks
        return self.block or (self.total - self.pre) / (self.cycles - self.pre_blocks)

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


def make_flow(config, block: float | None = None) -> Flow:
    """The protocol of a configuration (`suspend.config.Config`); `block` as in `Steps`, ignored under oscillation."""
    flow, duration = config.flow, config.duration
    if flow.type == "oscillatory":
        cycles = duration.cycles or math.ceil(duration.strain / (4.0 * flow.amplitude) - 1e-9)
        return Oscillatory(flow.amplitude, flow.phase, cycles)
    if flow.type == "steady":
        return Steps(duration.strain, 0.0, 1.0, 1.0, block)
    if flow.type == "reversal":
        return Steps(duration.strain, min(flow.reversal_strain, duration.strain), 1.0, -1.0, block)
    return Steps(duration.strain, 0.0, 0.0, 0.0, block)


def continued_flow(config, stored, block: float | None, begun: int) -> Flow | None:
    """The protocol of `config` with the blocks of a run that was started with the configuration `stored`.

    block : length of the run's blocks after a reversal, None where its configuration alone gave it; begun : number of
    cycles or blocks that are done or in progress. None where the two do not agree on those: a run is then never
    continued, since a state in the middle of one block would be taken for one in another.
    """
    if begun == 0:
        return make_flow(config)
    before = make_flow(stored, block)
    flow = make_flow(config, block_length(before))
    total = flow.accumulated(flow.cycles - 1, flow.period(flow.cycles - 1)) if flow.cycles else 0.0
    if isinstance(flow, Steps) and not math.isclose(total, flow.total, rel_tol=1e-9):
        return None
    same = all(
        math.isclose(before.period(k), flow.period(k), rel_tol=1e-9) and before.rate(k, 0.0) == flow.rate(k, 0.0)
        for k in range(min(begun, flow.cycles))
    )
    return flow if same else None


def block_length(flow: Flow) -> float | None:
    """Length of the blocks after a reversal; None under oscillation or where no such block exists."""
    if isinstance(flow, Oscillatory) or flow.cycles == flow.pre_blocks:
        return None
    return flow.period(flow.cycles - 1)


def rate_scale(config) -> float:
    """Gamma in the configuration's units: gamma0 omega, or the shear (reference) rate."""
    if config.flow.type == "oscillatory":
        return config.flow.amplitude * config.flow.omega
    return config.flow.rate
