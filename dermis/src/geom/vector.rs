//! Arithmetic on points and vectors, as plain arrays.

/// A point or vector in the plane, or on an unrolled surface.
pub type Point2 = [f64; 2];
/// A point or vector in space.
pub type Point3 = [f64; 3];

/// `a + b`.
#[inline]
pub fn add(a: Point3, b: Point3) -> Point3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `a - b`.
#[inline]
pub fn sub(a: Point3, b: Point3) -> Point3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// `factor * a`.
#[inline]
pub fn scale(a: Point3, factor: f64) -> Point3 {
    [a[0] * factor, a[1] * factor, a[2] * factor]
}

/// The scalar product.
#[inline]
pub fn dot(a: Point3, b: Point3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The vector product.
#[inline]
pub fn cross(a: Point3, b: Point3) -> Point3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The Euclidean length.
#[inline]
pub fn norm(a: Point3) -> f64 {
    dot(a, a).sqrt()
}

/// The Euclidean distance between two points.
#[inline]
pub fn distance(a: Point3, b: Point3) -> f64 {
    norm(sub(a, b))
}

/// `a` scaled to length one; the zero vector is not changed.
#[inline]
pub fn normalize(a: Point3) -> Point3 {
    let length = norm(a);
    if length > 0.0 { scale(a, 1.0 / length) } else { a }
}

/// The mean of some points.
pub fn centroid(points: &[Point3]) -> Point3 {
    let sum = points.iter().fold([0.0; 3], |sum, &point| add(sum, point));
    scale(sum, 1.0 / points.len() as f64)
}

/// The lower and the upper corner of the box around some points.
pub fn bounding_box<const N: usize>(points: impl IntoIterator<Item = [f64; N]>) -> [[f64; N]; 2] {
    points.into_iter().fold([[f64::INFINITY; N], [f64::NEG_INFINITY; N]], |[mut low, mut high], point| {
        for axis in 0..N {
            low[axis] = low[axis].min(point[axis]);
            high[axis] = high[axis].max(point[axis]);
        }
        [low, high]
    })
}

/// The longest distance between any two of some points: the longest edge of a triangle or a tetrahedron.
pub fn longest_edge(corners: &[Point3]) -> f64 {
    let others =
        |(index, a): (usize, &Point3)| corners[index + 1..].iter().map(move |b| distance(*a, *b)).fold(0.0, f64::max);
    corners.iter().enumerate().map(others).fold(0.0, f64::max)
}

/// The area of a triangle in space.
#[inline]
pub fn triangle_area(corners: [Point3; 3]) -> f64 {
    let [a, b, c] = corners;
    0.5 * norm(cross(sub(b, a), sub(c, a)))
}

/// The volume that a closed surface of triangles encloses, positive if they are counter-clockwise as seen from outside.
pub fn volume(triangles: impl IntoIterator<Item = [Point3; 3]>) -> f64 {
    triangles.into_iter().map(|[a, b, c]| dot(a, cross(b, c)) / 6.0).sum()
}

/// The unit normal of each node: the mean over its triangles by area; zero without one.
pub fn node_normals(nodes: &[Point3], triangles: impl IntoIterator<Item = [usize; 3]>) -> Vec<Point3> {
    let mut normals = vec![[0.0; 3]; nodes.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|node| nodes[node]);
        let twice_area = cross(sub(b, a), sub(c, a));
        triangle.iter().for_each(|&node| normals[node] = add(normals[node], twice_area));
    }
    normals.into_iter().map(normalize).collect()
}

/// The volume of a tetrahedron, positive if `abc` is counter-clockwise as seen from `d`.
#[inline]
pub(crate) fn tetrahedron_volume(corners: [Point3; 4]) -> f64 {
    let [a, b, c, d] = corners;
    dot(cross(sub(b, a), sub(c, a)), sub(d, a)) / 6.0
}
