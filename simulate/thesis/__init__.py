"""The tables, figures, algorithms and experiments of two theses, each beside ours.

An :class:`~simulate.thesis.entry.Entry` says what a thesis shows and where; most carry a function
of :mod:`simulate.thesis.runs` that measures or draws the same with this software. Figures of the
theses are read off the printed tables and sentences; what was not published (their objects, images
and outlines) is stood in for, and each result says by what.

References
----------
A. Gatto, "A Cloud based Reinforcement Learning Framework for humanoid grasping", Universita degli
Studi di Padova, 2016.
B. R. Kehoe, "Cloud-based Methods and Architectures for Robot Grasping", University of California,
Berkeley, 2014.
"""
