"""Pages of services: their forms and answers, jobs, datasets, and tools made of them."""
