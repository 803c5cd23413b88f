"""Results for people: tables, pictures and pages made from typed rows."""
