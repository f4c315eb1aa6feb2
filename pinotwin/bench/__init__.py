"""The blind bench: effects withheld from the model, produced by virtual machines, scored."""
