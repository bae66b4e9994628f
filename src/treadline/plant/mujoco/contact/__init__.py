"""Contact of the belts with the stair: Coulomb friction along and across the belt, rubber lugs, and their parameters."""
