"""The trained decision of the diagnosis: evidence rows of machines whose changes are known, and a logit on them."""
