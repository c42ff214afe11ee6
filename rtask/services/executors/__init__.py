"""Executors, which hold the instances of services: threads, processes, a Ray cluster."""
