"""The best path in one class: the padded corridor, least fuel, and the paper's random chains."""
