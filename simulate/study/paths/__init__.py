"""Paths remembered, beside paths planned anew."""
