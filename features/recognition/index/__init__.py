"""The growing index of stored views: files, log, snapshots and matching kernels."""
