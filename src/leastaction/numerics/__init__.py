"""What every half shares and no mechanics: argument checks, names, files, functions of time.

What an application needs to behave as the package does has its name here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from leastaction._names import lazily

if TYPE_CHECKING:
    from leastaction.numerics.arrays import Array, as_choice, as_number, read_only, smooth_rise
    from leastaction.numerics.blas import one_thread
    from leastaction.numerics.files import remove_earlier, write_text
    from leastaction.numerics.frozen import Frozen, restore_state, saved_state
else:
    __getattr__, __dir__ = lazily(
        __name__,
        {
            "leastaction.numerics.arrays": "Array as_choice as_number read_only smooth_rise",
            "leastaction.numerics.blas": "one_thread",
            "leastaction.numerics.files": "remove_earlier write_text",
            "leastaction.numerics.frozen": "Frozen restore_state saved_state",
        },
    )

__all__ = [
    "Array", "Frozen", "as_choice", "as_number", "one_thread", "read_only", "remove_earlier", "restore_state",
    "saved_state", "smooth_rise", "write_text",
]  # fmt: skip
