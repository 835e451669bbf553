"""What is made with the package: the command line, and the marionette that follows a motion."""

from __future__ import annotations
