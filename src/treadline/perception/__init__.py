"""From a depth camera's frame to the heading on the stair."""
