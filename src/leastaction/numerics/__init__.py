"""What every half shares and no mechanics: argument checks, names, files, functions of time.

What an application needs to behave as the package does has its name here.
"""

from __future__ import annotations

from leastaction._names import by_stub

__getattr__, __dir__, __all__ = by_stub(__name__)
