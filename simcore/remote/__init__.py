"""Controllers in other processes, in any language: messages, and the connection that carries them."""
