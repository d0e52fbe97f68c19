"""One way to repeat runs: campaigns with dispersed values and variants; sensitivities and impact maps."""
