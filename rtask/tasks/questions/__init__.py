"""Questions of robots to people: what they are, when they are worth their price, and answers."""
