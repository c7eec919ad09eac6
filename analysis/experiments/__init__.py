"""One module per experiment family; the registry finds what is here."""
