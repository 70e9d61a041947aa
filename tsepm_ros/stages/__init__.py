"""The stages of TSEPM 2018 as pure functions over arrays, a module each."""
