"""Access control: tokens, sign-in sessions, tickets and rate limits."""
