# SPDX-License-Identifier: Apache-2.0
"""The captions of the demo's pictures, in the order of the index page. {names} are filled in by the plot
that draws the picture (style.save); the finished caption is drawn below the picture and kept in the PNG."""

CAPTIONS = {
    "overview": "From a CT slice to the force of a puncture: the outline at 226 HU, the refined mesh, the mesh around the hole after "
    "the puncture, and the force on the hand while three slices are punctured one after the other.",
    "fig02_contours": "Contours of slice {slice} (paper, Fig. 2). Left: the default, sub-pixel contours at 226 HU. Right: the paper's "
    "preset, pixel chains after histogram equalisation. Its outline lies outside the cortex, on average {outside_mean:.1f} mm and at "
    "most {outside_max:.1f} mm beyond the sub-pixel contour around the vertebral body: equalised level {level:g} takes the "
    "brightest {share:.1f} % of all pixels as material, while bone above 226 HU fills only {bone_share:.1f} % of this image. The level therefore "
    "falls to {level_HU:g} HU, the density of the disc tissue around the body, and the outline follows the noise there. "
    "(How close the sub-pixel contours are to the phantom's exact outline: tests/bench/RESULTS.md.)",
    "fig04_simplified": "Simplification (paper, Fig. 4), slice {slice}: to {tolerance:g} mm with kept areas {default_points} points of the sub-pixel "
    "contours become {default_corners} corners; by Douglas-Peucker {paper_points} points of the paper's pixel chains become {paper_corners}.",
    "fig05_pslg": "Planar straight-line graph (paper, Fig. 5), slice {slice}, on the lattice of 2^-8 mm. Outer boundaries run counter-clockwise and "
    "holes clockwise in (u, v), so that the material lies on their left; v points down in the picture, which shows both reversed.",
    "fig07_carved": "Constrained Delaunay triangulation without the triangles outside the material (paper, Fig. 7), slice {slice}. Its smallest angle "
    "is {default_angle:.2f}\N{DEGREE SIGN} by default and {paper_angle:.2f}\N{DEGREE SIGN} with the paper's preset, before refinement.",
    "fig09_refined": "Refined mesh (paper, Fig. 9), slice {slice}, bound {bound:g}\N{DEGREE SIGN}. Default: {default_below} of {default_triangles} triangles are below the "
    "bound. Paper's preset: {paper_below} of {paper_triangles}, the smallest angle {paper_angle:.2f}\N{DEGREE SIGN}. Refinement cannot enlarge an angle of the outline: the jagged "
    "outline has {inputs} corners below 60\N{DEGREE SIGN}, the sharpest {input_angle:.2f}\N{DEGREE SIGN}, and near these the bound cannot be met. The report finds "
    "{explained} of the {paper_below} triangles at such an input angle and {unexplained} elsewhere.",
    "fig10_stack": "All slices of the sample scan, z stretched {stretch:g} times (paper, Fig. 10). The specks beside the bone with the paper's preset are "
    "islands of soft tissue whose pixels lie above the equalised level; islands below {island:g} mm\N{SUPERSCRIPT TWO} of pixels are dropped, these are larger. "
    "At 226 HU no soft tissue counts as material.",
    "fig13_remeshing": "The mesh around the hole before and after the puncture (paper, Fig. 13), one slice. Orange: triangles that the puncture made.",
    "fig13b_remeshing_three": "The mesh around the holes before and after the punctures (paper, Fig. 13), three slices. Orange: triangles that "
    "the puncture made.",
    "fig16_position": "Height of the tool tip over time (paper, Fig. 16): one slice at 12 cm, {rate} Hz. The recordings on the default mesh and on the "
    "mesh of the paper's preset are {same}.",
    "fig17_force": "Force on the hand over time (paper, Fig. 17): one slice at 12 cm, {rate} Hz, the same time axis as the position. At the puncture: slice, "
    "force and penetration. The force drops to zero when it reaches the threshold.",
    "fig18_position": "Height of the tool tip over time (paper, Fig. 18): three slices, {rate} Hz. The recordings on the default mesh and on the "
    "mesh of the paper's preset are {same}.",
    "fig19_force": "Force on the hand over time (paper, Fig. 19): three slices, {rate} Hz, the same time axis as the position. At each puncture: slice, force "
    "and penetration.",
    "fig20a_punctured_slice": "The punctured slice of the experiment with one slice.",
    "fig20_punctured_slices": "The punctured slices of the experiment with three slices (paper, Fig. 20).",
    "path": "Commanded and actual path of the tool tip in the session \"{scene}\". The commanded path is the scene's hand trajectory; the hand pulls the tip along it "
    "through a spring of {stiffness:g} N/m and a damper. While a slice resists, the tip stays behind by the force over the spring's stiffness.",
    "torques": "The eight motor torques over two sessions. With the force on the device's vertical axis the four motors of \N{GREEK SMALL LETTER THETA}1 carry equal "
    "shares and those of \N{GREEK SMALL LETTER THETA}4 almost none; beside a rim the sheet's force acts off the tool's axis and the shares differ. The largest torques are "
    "{upper:.2f} N m at \N{GREEK SMALL LETTER THETA}1 and {lower:.0f} mN m at \N{GREEK SMALL LETTER THETA}4; the motors' continuous torque is {continuous:g} N m.",
    "device": "The four-legged device at the first puncture of the session \"{scene}\", from the description in {description} and its closed-form inverse kinematics. "
    "The angles drawn here differ from the recorded encoder angles by at most {difference:.0e} rad. Projections are in leg 1's own frame: "
    "A is the axis of \N{GREEK SMALL LETTER THETA}1, E the elbow, C the ball joint on the plate, B the axis of \N{GREEK SMALL LETTER THETA}4, F its link's end, "
    "D the joint on EC. \N{GREEK SMALL LETTER THETA}3 and \N{GREEK SMALL LETTER THETA}6 are the second links' angles out of these planes.",
    "force_laws": "The force laws hooke and network in the middle of a vertebral body and 2 mm from a rim. Far from an edge both feel the tissue's stiffness; beside a rim the "
    "spring network is softer, and the threshold is reached deeper.",
    "deformed_middle": "The sheet around the tool and its mesh in the middle of the body, force law network: before contact, just before the puncture and after it.",
    "deformed_rim": "The sheet around the tool and its mesh 2 mm from a rim, force law network: before contact, just before the puncture and after it.",
    "needle": "A needle of 11 G down through {what} by the force law cutting: its strength comes from the HU under the tool. Above: the force over the depth of "
    "the tip, at most {largest:.0f} N; the plate renders {scale:g} of it. Below: the mean HU under the tool, over the depth of the front, which is the tip's less "
    "what tip and coupling give; slices that the front passes within a tick have no point. {slices} slices are cut, and the front takes {work:.0f} mJ; on the way out the wall of the hole holds the shaft by friction.",
}
