"""Questions with known answers: a gate that fails where one is wrong, and limits derived from healthy machines."""
