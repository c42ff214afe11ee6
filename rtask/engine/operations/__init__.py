"""The operations that robots and people may ask for, one file each."""
