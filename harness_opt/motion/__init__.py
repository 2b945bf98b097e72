"""All frames of a motion: placed along the clamps' path, continued from one to the next, over snap-through too."""
