"""Commands that take changes back."""
