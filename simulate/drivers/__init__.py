"""Drivers of real arms, each behind the same few methods: rosbridge, and NAOqi of a NAO."""
