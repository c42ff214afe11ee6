"""Reading: queries evaluated in reader processes, with deadlines and streamed results."""
