"""Points, lines and their control errors as pure functions on tensors."""
