//! Holds Tecplot text files.

/// Two ordered zones of points.
pub(crate) const ORDERED: &str = r#"# made
TITLE = "two blocks, of ZONE"
VARIABLES = "X [m]", "Y [m]"
 "Z [m]" "p"
ZONE T="a", I=2, J=2, K=3, F=POINT
0 0 0 1
1 0 0 2
0 1 0 3
1 1 0 4
0 0 1 5
1 0 1 6
0 1 1 7
1 1 1 8
0 0 2.5 9
1 0 2.5 10
0 1 2.5 11
1 1 2.5 1.2D1
ZONE T="b" I=2, J=2, K=2 F=POINT
5 0 0 1
6 0 0 2
5 1 0 3
6 1 0 4
5 0 1 5
6 0 1 6
5 1 1 7
6 1 1 8
"#;

/// A block one layer thick, with a variable at its cells.
pub(crate) const LAYER: &str = r#"VARIABLES = x, y, p, c
ZONE I=3, J=2, DATAPACKING=BLOCK, VARLOCATION=([4]=CELLCENTERED)
0 1 2 0 1 2
3*0 3*1
1 2 3 4 5 6
7.5 8.5
"#;

/// Elements at two times that share their nodes: a brick, a wedge, a pyramid and a tetrahedron.
pub(crate) const BRICKS: &str = r#"TITLE = "bricks"
VARIABLES = "x" "y" "z" "p" "c"
DATASETAUXDATA a = "b, ZONE"
ZONE N=10, E=4, DATAPACKING=BLOCK, ZONETYPE=FEBRICK, VARLOCATION=([5]=CELLCENTERED), STRANDID=1, SOLUTIONTIME=0.25, DT=(SINGLE SINGLE SINGLE SINGLE SINGLE)
0 1 1 0 0 1 1 0 .5 2
0 0 1 1 0 0 1 1 .5 .5
4*0 4*1 2 1.5
1 2 3 4 5 6 7 8 9 10
10 20 30 40
1 2 3 4 5 6 7 8
1 2 3 3 5 6 7 7
5 6 7 8 9 9 9 9
6 10 7 7 9 9 9 9
ZONE N=10, E=4, DATAPACKING=BLOCK, ZONETYPE=FEBRICK, VARLOCATION=([5]=CELLCENTERED), STRANDID=1, SOLUTIONTIME=0.5, VARSHARELIST=([1-3]=1), CONNECTIVITYSHAREZONE=1
10*-1
4*50
"#;

/// Tetrahedra and triangles in the old style.
pub(crate) const OLD: &str = r#"VARIABLES = "x" "y" "z" "p"
ZONE N=5, E=2, F=FEPOINT, ET=TETRAHEDRON
0 0 0 1
1 0 0 2
0 1 0 3
0 0 1 4
1 1 1 5
1 2 3 4
2 3 4 5
"#;

/// A surface of elements.
pub(crate) const SURFACE: &str = r#"VARIABLES = "x" "y" "z" "p"
ZONE NODES=5, ELEMENTS=2, DATAPACKING=POINT, ZONETYPE=FEQUADRILATERAL
0 0 0 1
1 0 0 2
1 1 0 3
0 1 0 4
2 .5 0 5
1 2 3 4
2 5 3 3
"#;

/// Points in a line, with coordinates under names of their own.
pub(crate) const LINE: &str = "VARIABLES = \"lon\" \"lat\" \"p\"\nZONE I=3\n0 0 1\n1 0 2\n2 0 3\n";

pub(crate) const ALL: [&str; 6] = [ORDERED, LAYER, BRICKS, OLD, SURFACE, LINE];
