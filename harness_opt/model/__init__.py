"""What a user describes and what a run gives back, as plain checked data."""
