"""The data of a diagnosis: logs on the twin's terms, with what the twin leaves of them."""
