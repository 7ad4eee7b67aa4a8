"""Places of bodies that leave the floor, from one camera.

A camera gives directions. What is missing, the distance, follows for a body on the floor from where its ray meets it,
for a body in the air from how gravity bends its path in the image, and coarsely for both from its apparent size.
`sightings` measures directions and sizes, `surfaces` says what bodies move on, `evidence` weighs what explains a
stretch of sightings, `chain` finds the cheapest division into stretches and solves them together with what `contacts`
says of their ends, `dividing` sets it up, `placing` puts the places into tracks.
"""
