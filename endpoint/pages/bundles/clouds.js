// What the view of clouds needs of three.js.
export {
  BufferGeometry, Color, Float32BufferAttribute, Group,
  PerspectiveCamera, Points, PointsMaterial, Scene, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
