"""Outlines of parts from drawings, images and point clouds."""
