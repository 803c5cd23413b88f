"""The board as one HTML file that needs no network: tables, figures, plan and environment."""
