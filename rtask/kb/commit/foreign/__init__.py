"""What a caller may say of the names and individuals of others."""
