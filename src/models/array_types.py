"""The array types that signatures are written with, so that shapes can be read and, in tests, are checked.

Training has to run where torch and lightning are all there is; there the names stand for nothing, since no signature
is evaluated at run time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxtyping import Bool as Bool
    from jaxtyping import Float as Float
    from jaxtyping import Float32 as Float32
    from jaxtyping import Float64 as Float64
    from jaxtyping import Int64 as Int64
    from jaxtyping import Shaped as Shaped
    from jaxtyping import UInt8 as UInt8
else:
    try:
        from jaxtyping import Bool, Float, Float32, Float64, Int64, Shaped, UInt8
    except ModuleNotFoundError:
        Bool = Float = Float32 = Float64 = Int64 = Shaped = UInt8 = Any
