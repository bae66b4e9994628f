"""What nobody knows of a stair and a camera, and what it does to the edges' direction."""
