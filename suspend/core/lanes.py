"""Short vectors of float64 for kernels: one register of 4 or 8 lanes as a value.

The compiler does not vectorise the rows of a stencil by itself (they are 4 to 8 points long and it cannot know that
grid and weights do not overlap), which costs a factor of five. A tuple of zeros stands for the number of lanes:
`LANES_4` or `LANES_8`; machines with shorter registers use several. Only for compiled code.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model

LANES_4, LANES_8 = (0,) * 4, (0,) * 8
_DOUBLE = ir.DoubleType()


class LanesType(types.Type):
    """`width` float64 lanes."""

    def __init__(self, width: int):
        self.width = width
        super().__init__(name=f"Lanes({width})")


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, ir.VectorType(_DOUBLE, kind.width))


def _address(context, builder, array_type, array, offset, width):
    data = cgutils.create_struct_proxy(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [offset]), ir.VectorType(_DOUBLE, width).as_pointer())


def _spread(builder, value, width):
    """The same scalar in every lane."""
    vector = builder.insert_element(
        ir.Constant(ir.VectorType(_DOUBLE, width), ir.Undefined), value, ir.Constant(ir.IntType(32), 0)
    )
    mask = ir.Constant(ir.VectorType(ir.IntType(32), width), [0] * width)
    return builder.shuffle_vector(vector, vector, mask)


@intrinsic
def load(typing, array, offset, lanes):
    """Lanes from elements offset, offset + 1, ... of the memory of a C-contiguous array, whatever its shape."""
    width = lanes.count

    def generate(context, builder, signature, values):
        return builder.load(_address(context, builder, array, values[0], values[1], width), align=8)

    return LanesType(width)(array, types.int64, lanes), generate


@intrinsic
def store(typing, array, offset, vector):
    """Write lanes to elements offset, offset + 1, ... of the memory of a C-contiguous array."""

    def generate(context, builder, signature, values):
        builder.store(
            values[2], _address(context, builder, array, values[0], values[1], vector.width), align=8
        )
        return context.get_dummy_value()

    return types.none(array, types.int64, vector), generate


def _as_lanes(builder, kind, value, width):
    return value if isinstance(kind, LanesType) else _spread(builder, value, width)


@intrinsic
def scaled(typing, factor, vector):
    """Factor (scalar or lanes) * vector."""
    factor = factor if isinstance(factor, LanesType) else types.float64

    def generate(context, builder, signature, values):
        return builder.fmul(_as_lanes(builder, factor, values[0], vector.width), values[1])

    return vector(factor, vector), generate


@intrinsic
def multiply_add(typing, factor, vector, addend):
    """Factor (scalar or lanes) * vector + addend, rounded once."""
    factor = factor if isinstance(factor, LanesType) else types.float64

    def generate(context, builder, signature, values):
        kind = ir.VectorType(_DOUBLE, vector.width)
        name, function = f"llvm.fma.v{vector.width}f64", ir.FunctionType(kind, [kind] * 3)
        fused = builder.module.declare_intrinsic(name, (), function)
        return builder.call(
            fused, [_as_lanes(builder, factor, values[0], vector.width), values[1], values[2]]
        )

    return vector(factor, vector, vector), generate


@intrinsic
def total(typing, vector):
    """Sum of the lanes, halves first (a fixed order)."""

    def generate(context, builder, signature, values):
        value, width = values[0], vector.width
        while width > 1:
            width //= 2
            low = ir.Constant(ir.VectorType(ir.IntType(32), width), list(range(width)))
            high = ir.Constant(ir.VectorType(ir.IntType(32), width), list(range(width, 2 * width)))
            value = builder.fadd(
                builder.shuffle_vector(value, value, low), builder.shuffle_vector(value, value, high)
            )
        return builder.extract_element(value, ir.Constant(ir.IntType(32), 0))

    return types.float64(vector), generate
