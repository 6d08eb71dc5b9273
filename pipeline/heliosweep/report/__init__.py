"""What a person looks at: figures, tables and one page per study."""
