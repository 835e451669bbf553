"""Right calls of everything public, and values that are wrong for nearly every argument."""
