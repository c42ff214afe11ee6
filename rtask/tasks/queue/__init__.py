"""Stored plans as a queue of steps: which robot takes what, and how each step ended.

A claim is a commit, made under the lock of the store with the state that it was decided on, so that
two robots never have one step or one thing.
"""
