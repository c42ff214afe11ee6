"""Datasets: folders of files with versions, which services take as data resources."""
