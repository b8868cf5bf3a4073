"""Short-time transport properties of hard-sphere suspensions: eta_inf, D_s, D_r and U of configurations.

    from suspend.oneshot import Method
    from suspend.short_time import equilibrium_scenes, short_time_properties
    result = short_time_properties(equilibrium_scenes(500, 0.4, configurations=4, seed=1), Method(accuracy=1e-3))
    print(result["D_s"].corrected, result["D_s"].error, result["D_s"].literature)
"""

from __future__ import annotations

from suspend.short_time.ensemble import (
    Property,
    ShortTimeProperties,
    equilibrium_scenes,
    short_time_properties,
)

__all__ = ["Property", "ShortTimeProperties", "equilibrium_scenes", "short_time_properties"]
