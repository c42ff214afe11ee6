"""What the price of asking a person does to goals, questions and costs."""
