"""What a caller may say of the individuals of others."""
