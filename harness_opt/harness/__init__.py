"""Harnesses: spans that free bodies and clips couple, brought into balance by what they pull with at their ends."""
