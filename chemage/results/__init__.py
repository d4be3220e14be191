"""Reports: figures of a run, comparisons of several results, and a page of HTML."""
