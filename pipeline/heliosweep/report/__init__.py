"""Pages, figures and tables of finished results."""
