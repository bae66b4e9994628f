"""Live depth cameras behind one protocol, and the checks of their streams."""
