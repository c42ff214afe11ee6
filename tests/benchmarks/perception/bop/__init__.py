"""The BOP benchmark of pose estimation: its folders, metrics and results (Hodan et al. 2018)."""
