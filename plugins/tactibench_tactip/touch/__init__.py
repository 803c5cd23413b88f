"""First touch: where depth begins."""
