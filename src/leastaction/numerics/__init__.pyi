from leastaction.numerics.arrays import Array, as_choice, as_number, read_only, smooth_rise
from leastaction.numerics.blas import one_thread
from leastaction.numerics.files import remove_earlier, write_text
from leastaction.numerics.frozen import Frozen, restore_state, saved_state

__all__ = [
    "Array", "Frozen", "as_choice", "as_number", "one_thread", "read_only", "remove_earlier", "restore_state",
    "saved_state", "smooth_rise", "write_text",
]  # fmt: skip
