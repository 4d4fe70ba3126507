"""Visual servoing: from associations in pictures to the next movement of the actor, without any input or output."""
