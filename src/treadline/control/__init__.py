"""From a linear model to belt speeds that keep the chair square."""
