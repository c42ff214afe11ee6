"""Workers that connect to the server from other machines (Kehoe 2014, 5.4 and 5.6)."""
