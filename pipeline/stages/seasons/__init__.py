"""The seasons of a run, each a task: in threads, in processes, or on a scheduler's workers."""
