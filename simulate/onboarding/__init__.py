"""Robots from URDF files: finding arms and hands, a workplace that suits them, and checks."""
