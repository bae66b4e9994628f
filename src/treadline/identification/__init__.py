"""From recorded belt speeds and motion to a linear model."""
