"""What happens at a contact: the interface of contact models, and the built-in ones (impact, persistent contact, grasp)."""
