"""Files of a knowledge base: journal, checkpoints, blobs, lock, backup and recovery."""
