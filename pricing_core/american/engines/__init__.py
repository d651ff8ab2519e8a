"""The engines that price a book, each on the contracts that it serves."""
