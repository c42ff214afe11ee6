"""Workers: calls of services carried out for a server, by as many processes as there is need."""
