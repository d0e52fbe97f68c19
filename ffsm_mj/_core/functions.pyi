BUILT: str
