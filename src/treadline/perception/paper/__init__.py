"""Algorithm 1 and Eq. (1) to (4) of the paper, as printed, with corrected forms next to them."""
