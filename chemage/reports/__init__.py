"""Reports: figures of a run, comparisons of several, and one page of HTML."""
