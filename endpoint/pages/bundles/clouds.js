// What the view of clouds and surfaces needs of three.js.
export {
  BufferGeometry, Color, Float32BufferAttribute, Group, Mesh, MeshBasicMaterial,
  PerspectiveCamera, Points, PointsMaterial, Scene, Uint32BufferAttribute, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
