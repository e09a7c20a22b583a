"""What is recorded as columns: a journal while a run goes on, Parquet when it is over."""
